/PROG  WELD_SEAM
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
   1:  UFRAME_NUM=2 ;
   2:  UTOOL_NUM=3 ;
   3:J P[1] 30% FINE    ;
   4:L P[2] 250mm/sec CNT50    ;
   5:  Arc Start[1] ;
   6:L P[3] WELD_SPEED FINE    ;
   7:  Arc End[1] ;
   8:J P[1] 30% FINE    ;
/POS
P[1]{
   GP1:
	UF : 2, UT : 3,	
	J1=    27.252 deg,	J2=    35.150 deg,	J3=    -7.038 deg,
	J4=    -1.946 deg,	J5=    58.403 deg,	J6=    10.724 deg
};
P[2]{
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
/END
