/PROG  ROUND_HOLE
/ATTR
OWNER		= MNEDITOR;
COMMENT		= "";
PROG_SIZE	= 1204;
PROTECT		= READ_WRITE;
TCD:  STACK_SIZE	= 0,
      TASK_PRIORITY	= 50;
DEFAULT_GROUP	= 1,*,*,*,*;
CONTROL_CODE	= 00000000 00000000;
/APPL
/MN
   1:  !a circle needs two points ;
   2:J P[1:start] 50% CNT100    ;
   3:L P[2:"hole; 1"] R[5:speed]mm/sec FINE    ;
   4:C P[3]    
    :  P[4] 100mm/sec CNT100 ACC80    ;
   6:C P[5]    
    :  P[2] 100mm/sec FINE    ;
   8:A P[4] 100mm/sec CNT100    ;
/POS
P[1:"start"]{
   GP1:
	UF : 2, UT : 3,	
	J1=    27.252 deg,	J2=    35.150 deg,	J3=    -7.038 deg,
	J4=    -1.946 deg,	J5=    58.403 deg,	J6=    10.724 deg
};
P[2:"hole; 1"]{
   GP1:
	UF : 2, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =   258.739  mm,	Y =  1872.358  mm,	Z =  2142.529  mm,
	W =   -40.279 deg,	P =   -50.319 deg,	R =   121.524 deg
};
P[3]{
   GP1:
	UF : 2, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =   -20.867  mm,	Y =  1844.280  mm,	Z =  2074.074  mm,
	W =   -55.037 deg,	P =   -46.969 deg,	R =   131.439 deg
};
P[4]{
   GP1:
	UF : 2, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =   -39.932  mm,	Y =  2116.764  mm,	Z =  1821.770  mm,
	W =   -24.419 deg,	P =   -54.935 deg,	R =   121.110 deg
};
P[5]{
   GP1:
	UF : 2, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =   129.601  mm,	Y =  1843.990  mm,	Z =  2052.466  mm,
	W =   -46.577 deg,	P =   -40.781 deg,	R =   125.763 deg
};
/END
