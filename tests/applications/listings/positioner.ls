/PROG  POSITIONER
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
   1:J P[1] 20% FINE    ;
   2:L P[2] 200mm/sec FINE    ;
   3:L P[3] 240cm/min CNT100 COORD    ;
   4:L P[4] 240cm/min CNT100 COORD PTH    ;
   5:J P[5] 20% FINE    ;
/POS
P[1]{
   GP1:
	UF : 2, UT : 3,	
	J1=    27.252 deg,	J2=    35.150 deg,	J3=    -7.038 deg,
	J4=    -1.946 deg,	J5=    58.403 deg,	J6=    10.724 deg
   GP2:
	UF : 2, UT : 3,	
	J1=    45.000 deg,	J2=     0.000 deg
};
P[2]{
   GP1:
	UF : 2, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =   258.739  mm,	Y =  1872.358  mm,	Z =  2142.529  mm,
	W =   -40.279 deg,	P =   -50.319 deg,	R =   121.524 deg
   GP2:
	UF : 2, UT : 3,	
	J1=    45.000 deg,	J2=     0.000 deg
};
P[3]{
   GP1:
	UF : 2, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =   -20.867  mm,	Y =  1844.280  mm,	Z =  2074.074  mm,
	W =   -55.037 deg,	P =   -46.969 deg,	R =   131.439 deg
   GP2:
	UF : 2, UT : 3,	
	J1=    45.000 deg,	J2=     0.000 deg
};
P[4]{
   GP1:
	UF : 2, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =   -39.932  mm,	Y =  2116.764  mm,	Z =  1821.770  mm,
	W =   -24.419 deg,	P =   -54.935 deg,	R =   121.110 deg
   GP2:
	UF : 2, UT : 3,	
	J1=    45.000 deg,	J2=     0.000 deg
};
P[5]{
   GP2:
	UF : 2, UT : 3,	
	J1=    90.000 deg,	J2=     0.000 deg
};
/END
