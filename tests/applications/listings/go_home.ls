/PROG  GO_HOME
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
   2:  PR[1]=P[2] ;
   3:  PR[1,3]=PR[1,3]+50 ;
   4:J PR[1:home] 10% FINE    ;
   5:J P[1] 100% FINE    ;
   6:L PR[R[4]] 100mm/sec FINE    ;
   7:L P[2] 100mm/sec FINE INC    ;
   8:J P[3] 20% FINE Skip,LBL[1]    ;
   9:  CALL GOHOME(1,'P[1]') ;
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
	UF : 2, UT : 3,	
	J1=    27.199 deg,	J2=    36.801 deg,	J3=   -17.124 deg,
	J4=    -3.116 deg,	J5=    64.026 deg,	J6=    -4.209 deg
};
/END
